"""Flight among movers: seen by the LiDAR, kept in sets, avoided by motions that are verified against the sets."""
