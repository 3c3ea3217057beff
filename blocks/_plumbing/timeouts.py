"""The declaration of the parameter `timeout` of a sensor."""

from __future__ import annotations

from graph import Param


def timeout_param(missing: str = "reply", default: float = 0.1) -> Param[float]:
    """Return the declaration of a sensor's timeout. missing : what does not arrive; default : s"""
    text = f"time without a {missing} after which the run ends in the safe stop; 0 disables it"
    return Param(default, "s", text, min=0.0, fixed=True, kernel=False)
