"""The guide: a page in the browser on which a person moves the probe, with advice."""
