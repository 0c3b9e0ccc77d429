"""Evidence: one record per episode, with all that is needed to question a result.

This floor knows environments and what they tell, and nothing of how policies are trained or judged.
"""
