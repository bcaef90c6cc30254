"""Convolutional networks: weights files -> ONNX models -> outputs for crops or whole images."""
