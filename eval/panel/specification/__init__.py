"""The panel's specification: read from TOML, checked, expanded into rows and cells.

Knows what is to be done and nothing of what came out.
"""
