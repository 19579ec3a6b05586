"""What an agent observes beside the frame, and in what form it gets both."""
