"""The table before arming: made by the control process (table), printed by the recorder (text)."""
