"""Camera, frames, gimbal law, guidance and limits: from a target estimate to a command.

No file, socket, thread or clock.
"""
