"""Compile the kernels for Tickwork's kernel ABI. Everything else is in pyproject.toml."""

from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

import cext

setup(
    ext_modules=cythonize(
        [
            Extension(
                "tickwork_moteus.kernels",
                ["tickwork_moteus/kernels.pyx"],
                extra_compile_args=["-O2", "-ffp-contract=off"],
            )
        ],
        include_path=[str(Path(cext.__file__).parent.parent)],
        language_level=3,
    )
)
