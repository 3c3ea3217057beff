"""Make a test again that failed while the machine stood still.

A virtual machine may be held up for 50 ms, or for seconds. A run then does what it should, and stops its drives; a test
that waits for torque fails, which says nothing about the product. It is made again, at most ATTEMPTS times in all; what
failed is shown at the end of the session. A test that fails while no processor stands still has failed.
"""

import os
import time

import pytest
from _pytest.runner import runtestprotocol

from tests.standstill import FILE, Watching, standstills

ATTEMPTS = 3
REPEATED = "repeated"


class Repeating:
    """The plugin. Workers read what the processes of the session that has started them have noticed."""

    def __init__(self):
        self.watching = Watching() if FILE not in os.environ else None
        self.repeated = []

    def pytest_unconfigure(self):
        if self.watching:
            self.watching.end()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item, nextitem):
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        disturbed = []
        while True:
            began = time.monotonic()
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            bad = next((report for report in reports if report.failed), None)
            if bad is None or len(disturbed) == ATTEMPTS - 1 or not (lengths := standstills(began)):
                break
            disturbed.append(f"{item.nodeid} while a processor stood still for {in_ms(lengths)}\n{bad.longreprtext}\n")
            item.session._setupstate.teardown_exact(None)
            item._initrequest()
        reports[-1].user_properties += [(REPEATED, text) for text in disturbed]
        for report in reports:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def pytest_runtest_logreport(self, report):
        self.repeated += [text for name, text in report.user_properties if name == REPEATED]

    def pytest_terminal_summary(self, terminalreporter):
        if self.repeated and self.watching:
            terminalreporter.section("failed, and made again")
            for text in self.repeated:
                terminalreporter.write_line(text)
            lengths = standstills()
            terminalreporter.write_line(f"{len(lengths)} standstills in the session, of at most {in_ms(lengths)}")


def in_ms(lengths):
    return f"{1e3 * max(lengths):.0f} ms"
