"""What a panel's records say: remedies, rankings, pairs, engines that agree, costs, maps.

Knows the matrix and the layout of one panel; the declared family is judged in `verdict`.
"""
