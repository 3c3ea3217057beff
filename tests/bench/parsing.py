"""Parsers of the commands."""

from runtime.cli.parsing import Parser


def parser_of(name: str, description: str) -> Parser:
    """Return a parser that names this program in its help."""
    parser = Parser(f"bench {name}", description)
    parser.prog = f"python -m tests.bench {name}"
    return parser
