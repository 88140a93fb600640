"""The lane network at run time: ONNX Runtime, no torch."""
