"""Many runs of one diagram: studies and optimisation."""
