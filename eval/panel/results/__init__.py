"""What came out of a panel: evidence reduced to a matrix, judged, written as ``panel.json``.

Knows records and verdicts; how they are shown is the report's business.
"""
