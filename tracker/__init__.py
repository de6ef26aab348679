"""SiamAPN++, the box filter and the target's states: from a frame to a target estimate."""
