"""Numbers, names, tables and HTML that all reports share."""
