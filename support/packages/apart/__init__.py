"""Packages whose pins fit no other's: each in a Python environment of its own, behind a process.

The process is started by that environment's interpreter, serves one file of ours and is spoken to
over pipes, a line of JSON for each call and each answer.
"""
