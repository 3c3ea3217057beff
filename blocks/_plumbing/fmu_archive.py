"""Size of the files in the archive of an FMU, before it is unpacked."""

from __future__ import annotations

import os
import shutil
import zipfile

SIZE_LIMIT = 1 << 30  # bytes that an FMU unpacks to
DESCRIPTION_LIMIT = 64 << 20  # bytes of modelDescription.xml, which takes a multiple of it in memory
FILES_LIMIT = 10_000


def is_used(name: str) -> bool:
    """Return whether a simulation uses a file of an FMU."""
    return name.startswith(("modelDescription.xml", "binaries/", "resources/"))


def check_sizes(file: str, folder: str) -> None:
    """Raise ValueError for an FMU that unpacks to too much.

    The sizes are those in the directory of the archive. zipfile unpacks no more of a file than its size there.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            sizes = {each.filename: each.file_size for each in archive.infolist() if is_used(each.filename)}
    except (OSError, zipfile.BadZipFile) as error:
        raise ValueError(f"it is not an FMU that can be read: {error}") from None
    size, free = sum(sizes.values()), shutil.disk_usage(folder).free
    largest = max(sizes, key=lambda name: sizes[name], default="")
    if (own := sizes.get("modelDescription.xml", 0)) > DESCRIPTION_LIMIT:
        raise ValueError(
            f"its modelDescription.xml unpacks to {mebibytes(own)}, above the limit of {mebibytes(DESCRIPTION_LIMIT)}: "
            "export the FMU with fewer variables"
        )
    if size > SIZE_LIMIT:
        raise ValueError(
            f"it unpacks to {mebibytes(size)}, above the limit of {mebibytes(SIZE_LIMIT)}: export it without the files "
            f"that a simulation does not need, the largest is {largest} of {mebibytes(sizes[largest])}"
        )
    if len(sizes) > FILES_LIMIT:
        raise ValueError(f"it has {len(sizes)} files, above the limit of {FILES_LIMIT}: export it with fewer resources")
    if size > free:
        raise ValueError(
            f"it unpacks to {mebibytes(size)}, and {os.path.dirname(folder)} has {mebibytes(free)} left: free space "
            "there, or set the environment variable TMPDIR to a folder on another disk"
        )


def mebibytes(size: int) -> str:
    """Return a size in bytes as text in MiB."""
    return f"{size / (1 << 20):.0f} MiB"
