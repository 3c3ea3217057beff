# Generated from the source by `python -m cext.stubs`. Do not edit.
from cext.schedule.arming import Arming

class Waiting(Arming): ...
