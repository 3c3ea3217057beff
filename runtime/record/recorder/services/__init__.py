"""Services of sinks and logs, one per module, which is named as the service; the class is its SERVICE."""
