"""A panel's figures as papers print them: column width, 8 pt, labelled axes, no titles.

The same descriptions as the page's figures, hence the same numbers and ticks.
"""
