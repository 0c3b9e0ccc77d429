"""The typed model of ``panel.json``: written, read and published as JSON Schema from here alone.

Knows what a finished panel says, not how it came about or how it is drawn.
"""
