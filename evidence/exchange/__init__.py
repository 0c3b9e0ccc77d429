"""Records taken to the formats of other tools: tables, data sets of episodes, logs of robots.

Knows records and formats; what a format cannot hold is left out and counted, or refused.
"""
