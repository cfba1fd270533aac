"""The figures of reports: one file per question that an engineer asks first."""
