"""What a scanner's receiver does to the echoes: the noise of its electronics, and time gain compensation."""
