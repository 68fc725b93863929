"""The command line `tbm-monitor`."""
