"""Units in ASCII, for the headers of files.

A recording is read where nothing was compiled: this module does not import graph.
"""

import re

SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def ascii_name(unit: str) -> str:
    """Return a canonical unit in ASCII: 'N*m' for 'N·m', 'm/s^2' for 'm/s²', 'degC' for '°C'.

    graph.units parses it to the same unit.
    """
    text = "*".join(unit.split("·")).replace("°C", "degC").replace("µ", "u").replace("Ω", "ohm")
    return re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda power: "^" + power[0].translate(SUPERSCRIPTS), text)
