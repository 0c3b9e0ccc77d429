"""The frame of every page: its template, its sheet, its one script and its security policy.

Knows a page that opens offline, not what is shown on it.
"""
