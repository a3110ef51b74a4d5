"""A campaign's report: one page that needs nothing else, Markdown, JSON."""
