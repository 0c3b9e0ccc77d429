"""Families that maps are made of: Runge-Kutta tableaux, linearly implicit kicks."""
