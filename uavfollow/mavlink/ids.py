"""Numbers of the MAVLink definitions that are sent, each with its enumeration; tests compare them with the dialect."""

from __future__ import annotations

# MAV_COMPONENT
AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
CAMERA_COMPONENT = 100  # MAV_COMP_ID_CAMERA: QGroundControl looks for cameras only at 100..105
CONTROLLER_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER: setpoints, gimbal messages and STATUSTEXT come from it

# MAV_TYPE, MAV_AUTOPILOT, MAV_STATE of HEARTBEAT (0)
TYPE_ONBOARD_CONTROLLER = 18  # never MAV_TYPE_GCS: that would mask the autopilot's GCS failsafe
TYPE_CAMERA = 30
AUTOPILOT_INVALID = 8  # "not a flight controller"
AUTOPILOT_ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
MODE_FLAG_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
TYPES_COPTER = frozenset({2, 3, 4, 13, 14, 15, 29})  # MAV_TYPE of what ArduCopter flies: quadrotor to dodecarotor
STATE_STANDBY = 3
STATE_ACTIVE = 4
STATE_CRITICAL = 5  # and above: a failsafe is pending

# MAV_FRAME
FRAME_LOCAL_NED = 1  # the frame that means the same on ArduPilot and PX4

# POSITION_TARGET_TYPEMASK: a set bit means "ignore"
IGNORE_POSITION = 1 | 2 | 4
IGNORE_ACCELERATION = 64 | 128 | 256
IGNORE_YAW = 1024
# 1479: velocity and yaw rate are used. Whole groups only: ArduPilot stops the vehicle on a partly ignored group.
VELOCITY_YAW_RATE_MASK = IGNORE_POSITION | IGNORE_ACCELERATION | IGNORE_YAW

# GIMBAL_MANAGER_FLAGS. Both autopilots choose by YAW_LOCK alone; the frame bits are sent as the standard asks.
ROLL_LOCK = 4
PITCH_LOCK = 8
YAW_LOCK = 16
YAW_IN_VEHICLE_FRAME = 32
YAW_IN_EARTH_FRAME = 64
FOLLOW_FLAGS = ROLL_LOCK | PITCH_LOCK | YAW_IN_VEHICLE_FRAME  # 44: yaw from the vehicle's heading
LOCK_FLAGS = ROLL_LOCK | PITCH_LOCK | YAW_LOCK | YAW_IN_EARTH_FRAME  # 92: yaw from north

# MAV_CMD
CMD_SET_MESSAGE_INTERVAL = 511  # MAV_CMD_SET_MESSAGE_INTERVAL
CMD_REQUEST_MESSAGE = 512  # MAV_CMD_REQUEST_MESSAGE
CMD_GIMBAL_MANAGER_CONFIGURE = 1001  # MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
CONFIGURE_KEEP = -1.0  # leave that control as it is
CONFIGURE_RELEASE = -3.0  # give control up if it is ours
# -2 ("myself") is never sent: PX4 then gives control to the autopilot.

# MAV_LANDED_STATE of EXTENDED_SYS_STATE (245)
LANDED_STATE_IN_AIR = 2

# ESTIMATOR_STATUS_FLAGS, the same bits in EKF_STATUS_REPORT (193) and ESTIMATOR_STATUS (230)
ESTIMATOR_VELOCITY_HORIZ = 2
ESTIMATOR_POSITION_HORIZ = 8 | 16  # relative or absolute: either serves for following

# Messages that are asked for
MESSAGE_HEARTBEAT = 0
MESSAGE_ATTITUDE = 30
MESSAGE_LOCAL_POSITION_NED = 32
MESSAGE_EKF_STATUS_REPORT = 193
MESSAGE_EXTENDED_SYS_STATE = 245
MESSAGE_GIMBAL_MANAGER_STATUS = 281
MESSAGE_GIMBAL_DEVICE_ATTITUDE_STATUS = 285
