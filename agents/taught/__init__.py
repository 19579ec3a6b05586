"""Agents that a teacher shows what to do while they learn, and who act alone afterwards."""
