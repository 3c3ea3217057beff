"""Units in ASCII, for the headers of files. Imports nothing of the language, so that a recording can be read where
nothing was compiled.
"""

import re

SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def ascii_name(unit):
    """A canonical unit in ASCII: 'N·m' gives 'N*m', 'm/s²' gives 'm/s^2', '°C' gives 'degC'. graph.units reads it back
    as the same.
    """
    text = "*".join(unit.split("·")).replace("°C", "degC").replace("µ", "u").replace("Ω", "ohm")
    return re.sub("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda power: "^" + power[0].translate(SUPERSCRIPTS), text)
