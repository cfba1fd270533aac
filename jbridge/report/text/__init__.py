"""Numbers, names, tables and HTML that all reports share, and the summary in a terminal."""
