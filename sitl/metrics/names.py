"""The names of the metrics of a run, in the order in which reports show them."""

from __future__ import annotations

METRIC_NAMES: tuple[str, ...] = (
    "final_locked_on_target",
    "lock_share",
    "honest_lock_share",
    "in_picture_share",
    "false_confirmed_share",
    "iou_mean",
    "centre_err_rms_px",
    "centre_err_p95_px",
    "centre_err_rms_deg",
    "standoff_err_rms_m",
    "height_err_rms_m",
    "bearing_err_rms_deg",
    "occlusion_longest_survived_s",
    "reacquire_median_s",
    "declare_loss_median_s",
    "hidden_longest_s",
    "visible_again_s",
    "reacquired",
    "reacquire_s",
    "leave_locked_s",
    "gimbal_cmd_rms_deg_s",
    "setpoint_rate_hz",
    "setpoint_gap_max_s",
    "commands_after_override",
    "limit_violations",
    "geolocation_err_rms_m",
    "delay_est_err_ms",
    "realtime_factor",
)
# How fast the computer was says nothing of the flight, and changes from run to run.
NEVER_GATED = frozenset({"realtime_factor"})
