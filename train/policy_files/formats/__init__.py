"""What a policy's weights can be kept in: one room or file for each format.

Knows formats; a side-car's card is given to them.
"""
