"""What commands have in common: arguments, tables and text that fit, numbers, how a command ends.

Knows terminals, not what is told in them.
"""
