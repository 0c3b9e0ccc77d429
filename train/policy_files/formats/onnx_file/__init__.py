"""Policies as ONNX: written with all that decides their actions, read without running a stranger's.

A feed-forward graph becomes our own policy; any other is run by onnxruntime. Metadata holds what a
side-car does.
"""
