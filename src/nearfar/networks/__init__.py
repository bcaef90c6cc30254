"""Convolutional networks: weights files -> ONNX graphs -> outputs for crops of an image."""
