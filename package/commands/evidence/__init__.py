"""``integ-gym evidence``: every one of its subcommands that is more than a call.

Knows arguments and terminals; records are the evidence floor's.
"""
