"""What a setting is put together from: probe, imaging and anatomy from files and records; its frames."""
