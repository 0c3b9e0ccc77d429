"""Optional packages, versions of installed ones, and registries made of the modules in a folder.

Knows how packages are found and named, not what they are for.
"""
