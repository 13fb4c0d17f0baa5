"""Tables, figures, JSON documents and the HTML report.

Contains everything that is shown to people. Imports only `core`; it draws what it is given and
computes no statistics of its own. Read `table.py` first, then `document.py` for the JSON
schema and `page.py` for the report.
"""
