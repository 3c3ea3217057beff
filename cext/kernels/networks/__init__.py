"""Neural networks in ONNX form, run by ONNX Runtime through its C API."""
