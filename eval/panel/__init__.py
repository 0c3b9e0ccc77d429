"""The panel: what is asked, how it is run, and what came out.

Rooms in this order: specification, running, results; ``panel.json`` has its model here.
"""
