"""`build FILE.pyx...`: compile native blocks beside their sources."""

import logging
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cext
from runtime.cli.parsing import Parser
from runtime.host.console.terminal import print_lines
from runtime.host.errors import OK, BadInput
from runtime.host.optional_dependencies import need

FLAGS = [
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
]  # as of Tickwork's own kernels: the same bits on every processor


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for a source that does not compile."""
    parser = Parser(
        "build",
        "Compile the kernels of native blocks. The module is written beside its source, my_kernels.pyx, and imported "
        "as my_kernels. Needs a C compiler, Cython and setuptools.",
    )
    parser.add_argument("files", metavar="FILE.pyx", nargs="+", type=Path, help="Cython source of kernels")
    for file in parser.parse_args(arguments).files:
        print_lines([str(build(file))])
    return OK


def build(file: Path) -> Path:
    """Compile a Cython source under its full name. Returns the path of the module beside it. Raises BadInput."""
    if file.suffix != ".pyx" or not file.is_file():
        raise BadInput(f"{file} is not a Cython source: pass an existing file that ends in .pyx")
    setuptools = need("setuptools", "build")
    translate = need("Cython.Build", "build").cythonize
    wrong = (need("Cython.Compiler.Errors", "build").CompileError, need("setuptools.errors", "build").CCompilerError)
    folder, names = file.absolute().parent, [file.stem]
    while (folder / "__init__.py").exists():
        folder, names = folder.parent, [folder.name, *names]
    extension = setuptools.Extension(".".join(names), [str(file.absolute())], extra_compile_args=FLAGS, libraries=["m"])
    logging.disable(logging.INFO)  # the command lines of the compiler
    try:
        with TemporaryDirectory() as scratch:
            extensions = translate(
                [extension],
                build_dir=scratch,
                include_path=[str(Path(cext.__file__).parents[1])],
                language_level=3,
                compiler_directives={"boundscheck": False, "wraparound": False, "cdivision": True},
                quiet=True,
                force=True,
            )
            distribution = setuptools.Distribution({"name": file.stem, "ext_modules": extensions})
            command = distribution.get_command_obj("build_ext")
            command.build_lib, command.build_temp, command.force = str(folder), scratch, True
            command.ensure_finalized()
            command.run()
    except wrong:  # which the compilers have printed
        raise BadInput(f"{file} does not compile: correct the errors above") from None
    finally:
        logging.disable(logging.NOTSET)
    return file.parent / Path(command.get_ext_fullpath(extension.name)).name
