"""Compiles the kernels against Tickwork's public kernel ABI. All else stands in pyproject.toml."""

from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

import cext

setup(
    ext_modules=cythonize(
        [
            Extension(name, [f"{name.replace('.', '/')}.pyx"], extra_compile_args=["-O2", "-ffp-contract=off"])
            for name in ("gaitlab.kernels", "gaitlab.drive.kernels")
        ],
        include_path=[str(Path(cext.__file__).parent.parent)],
        language_level=3,
    )
)
