"""The tabs of the page, one module each. A new tab is a line here and a module.

Each module has `controls`, which returns the HTML of its controls without their values, and
`show`, which calls public functions and publishes what the tab shows. Both are imported when the
tab is first opened. Read `outlines.py` first, the shortest.
"""

# The title of each, in the order on the page.
TABS = {
    'aspects': 'Aspects',
    'outlines': 'Outlines',
    'reorientation': 'Reorientation',
    'forecast': 'Forecast',
    'track': 'Track',
    'compare': 'Compare',
    'counts': 'Hand counts',
    'export': 'Export',
}
