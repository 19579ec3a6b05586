"""What results owe to the protocol: how hard each row is to tune, and the tables beside the grid."""
