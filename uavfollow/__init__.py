"""The application: from camera frames to MAVLink setpoints."""

import os

# pymavlink picks its protocol version when it is first imported; without this it speaks MAVLink 1 and lacks every
# message above id 255. This package is imported before any of its modules can import pymavlink.
os.environ["MAVLINK20"] = "1"

__version__ = "0.1.0"
