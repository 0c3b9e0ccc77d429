"""Every subcommand of ``integ-gym``, one module each, named as it is called.

Knows arguments and terminals; the work is done behind the other floors' doors.
"""
