"""What `make unseen` trains, measures and draws."""
