"""Optional libraries of tests, imported by the first test that uses them: the collection of all tests is quick."""

import pytest


class Library:
    """Attributes of a module. A test that reads one is skipped where the library is not installed."""

    def __init__(self, name):
        self._name = name

    def __getattr__(self, attribute):
        why = f"{self._name} is not installed: pip install 'tickwork[test]'"
        return getattr(pytest.importorskip(self._name, reason=why), attribute)
