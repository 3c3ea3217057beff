"""Files of a neural network: the ONNX file, further files with its weights, and why one cannot be used."""

from __future__ import annotations

import re
from pathlib import Path

LOCATION = re.compile(rb"\x0a\x08location\x12([\x01-\x7f])", re.S)  # of external data, in a TensorProto of onnx.proto
LFS = b"version https://git-lfs.github.com/"


def weights_of(content: bytes) -> list[str]:
    """Return the names of the files beside an ONNX file that contain its weights, as PyTorch 2.9 exports them.

    content : bytes of the ONNX file
    """
    found = (content[match.end() : match.end() + match[1][0]] for match in LOCATION.finditer(content))
    return sorted({name.decode(errors="replace") for name in found})


def reason(path: Path, content: bytes, error: str, version: str) -> str:
    """Return why a file cannot be used, and the remedy.

    content : bytes of the file; error : text of ONNX Runtime; version : version of ONNX Runtime
    """
    if content.startswith(LFS):
        return "is a pointer of Git LFS and not the network: install git-lfs, and fetch it with `git lfs pull`"
    missing = [name for name in weights_of(content) if not (path.parent / name).is_file()]
    if missing:
        return (
            f"its weights are in {', '.join(missing)}, which is not beside it: copy both, or export the network with "
            "its weights inside, as torch.onnx.export(..., external_data=False) does"
        )
    newer = f"ONNX Runtime {version} does not support: pip install --upgrade onnxruntime, or export the network with "
    if opset := re.search(r"[Oo]pset (\d+) is under development", error):
        return f"uses operators of opset {opset[1]}, which {newer}an older opset_version"
    if form := re.search(r"IR version: (\d+)", error):
        return f"has version {form[1]} of the ONNX format, which {newer}an older version of onnx"
    if "protobuf parsing failed" in error:
        return "is not an ONNX file, or is damaged: export or copy it again"
    return error
