"""Policies as evaluation sees them: observations in, the deterministic action out.

Knows networks as arrays; how they were trained or stored is not its business.
"""
