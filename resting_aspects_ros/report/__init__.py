"""Tables, figures, JSON documents and the HTML report.

This package imports only `core`. It formats and draws distributions, and leaves statistics to
`core`. Read `table.py` first, then `document.py` for the JSON schema and `page.py` for the
report.
"""
