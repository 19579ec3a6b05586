"""PPO whose critic is told the truth while it learns; the policy sees what every agent sees."""
