"""The native part of the build: every .pyx in cext becomes an extension module. All else stands in pyproject.toml."""

from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

# -ffp-contract=off keeps results bit-identical where the processor could fuse a multiply with an add (arm64).
FLAGS = ["-O2", "-ffp-contract=off", "-fno-math-errno", "-Wno-unreachable-code"]

extensions = [
    Extension(".".join(source.with_suffix("").parts), [str(source)], extra_compile_args=FLAGS, libraries=["m"])
    for source in sorted(Path("cext").rglob("*.pyx"))
]

setup(
    ext_modules=cythonize(
        extensions,
        language_level=3,
        compiler_directives={
            "boundscheck": False,
            "wraparound": False,
            "cdivision": True,
            "initializedcheck": False,
            "embedsignature": True,
        },
    )
)
