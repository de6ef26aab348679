"""`uavfollow sim` and `uavfollow sitl` as their users meet them."""

from __future__ import annotations

import json

import cv2
import pytest
import yaml

from sitl.scenario import builtin_names
from uavfollow.__main__ import main
from uavfollow.mavlink.tlog import TlogReader
from uavfollow.sim.files import SIM_FILES


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


@pytest.fixture
def short(tmp_path, capsys):
    """The default scenario, four seconds long, as a file; and what it takes to change it."""
    from importlib import resources

    text = (resources.files("sitl") / "scenarios" / "default.yaml").read_text()
    values = yaml.safe_load(text)
    values["duration_s"] = 4.0
    values["target"]["path"]["start_s"] = 2.5
    values["criteria"] = [{"metric": "lock_share", "min": 0.5}]

    def write(**changes):
        path = tmp_path / "short.yaml"
        path.write_text(yaml.safe_dump(values | changes))
        return str(path)

    return write


def test_a_geometry_flight_writes_its_files_and_tells_its_numbers(short, tmp_path, capsys):
    out = tmp_path / "out"
    assert run("sim", short(), "--geometry", "--out", out) == 0
    printed = capsys.readouterr().out
    assert "lock_share" in printed
    assert "ok" in printed
    made = {p.name for p in out.iterdir()}
    assert made == set(SIM_FILES) - {"overlay.mp4", "snapshots.jpg"}, "a flight without pictures has no film"
    told = json.loads((out / "run.json").read_text())
    assert (told["scenario"], told["seed"], told["engine"]) == ("default", 0, "geometry camera")
    assert told["passed"] is True
    rows = (out / "steps.csv").read_text().splitlines()
    assert len(rows) > 30
    kinds = {m.get_type() for _, m in TlogReader(out / "link.tlog").messages()}
    assert {"HEARTBEAT", "COMMAND_ACK", "ATTITUDE", "SET_POSITION_TARGET_LOCAL_NED",
            "GIMBAL_MANAGER_SET_ATTITUDE", "GIMBAL_DEVICE_ATTITUDE_STATUS"} <= kinds  # fmt: skip


def test_a_flight_with_the_network_makes_a_film_of_the_scenarios_length(short, tmp_path, capsys):
    out = tmp_path / "out"
    code = run("sim", short(tracker_compute_delay_s=0.25), "--out", out, "--json")
    assert code in (0, 1)
    told = json.loads(capsys.readouterr().out)
    assert told["engine"].startswith("model s")
    film = cv2.VideoCapture(str(out / "overlay.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(3.4 * 30, abs=12)
    film.release()
    assert (out / "snapshots.jpg").is_file()


def test_a_criterion_that_is_not_met_is_exit_code_one(short, tmp_path, capsys):
    path = short(criteria=[{"metric": "lock_share", "min": 0.999999}])
    assert run("sim", path, "--geometry", "--out", tmp_path / "out") == 1
    assert "FAIL" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "run.json").read_text())["passed"] is False


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"duraton_s": 3}, "did you mean duration_s?"),
        ({"duration_s": -1}, "duration_s"),
        ({"schema": 7}, "schema"),
        ({"vehicle": {"max_titl_deg": 20}}, "did you mean max_tilt_deg?"),
        ({"criteria": [{"metric": "lock_shar", "min": 1}]}, "did you mean lock_share?"),
    ],
)
def test_a_bad_scenario_is_one_line(short, tmp_path, capsys, changes, said):
    assert run("sim", short(**changes), "--geometry", "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_target_inside_a_building_is_one_line(short, tmp_path, capsys):
    path = {"points_ne_m": [[31, -18]]}
    target = {"kind": "car", "name": "target", "colour_rgb": [176, 28, 30], "path": path}
    assert run("sim", short(target=target), "--geometry", "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert "building" in error
    assert "target" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["defualt"], "did you mean default?"),
        (["nowhere.yaml"], "nowhere.yaml"),
        (["--model", "nothing.safetensors"], "no such weights file"),
        (["--seed", "-1"], "--seed -1"),
        (["--threads", "0"], "--threads 0"),
        (["--sed", "1"], "did you mean --seed?"),
    ],
)
def test_bad_arguments_are_one_line(arguments, said, tmp_path, capsys):
    assert run("sim", *arguments, "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_what_is_not_built_is_pending_and_does_not_pass(short, tmp_path, capsys):
    path = short(vehicle={"flavour": "px4"})
    assert run("sim", path, "--geometry", "--out", tmp_path / "out") == 1
    assert "pending" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_output_in_the_way_is_said_before_the_flight(short, tmp_path, capsys):
    (tmp_path / "out" / "run.json").mkdir(parents=True)
    assert run("sim", short(), "--geometry", "--out", tmp_path / "out") == 2
    assert "run.json" in capsys.readouterr().err


def test_list_and_show(capsys):
    assert run("sitl", "list") == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in builtin_names())
    assert run("sitl", "show", "default") == 0
    assert yaml.safe_load(capsys.readouterr().out)["name"] == "default"
    assert run("sitl", "show", "defualt") == 2
    assert "did you mean default?" in capsys.readouterr().err


def test_the_autopilot_alone_answers_over_udp(capsys):
    """A client in the same process: the autopilot's loop runs for a second, and the bytes wait in the socket."""
    import socket

    from pymavlink.dialects.v20 import ardupilotmega as dialect

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        client.settimeout(5.0)
        port = client.getsockname()[1]
        assert run("sitl", "autopilot", "--link", f"udpout:127.0.0.1:{port}", "--for-s", "1.2") == 0
        parser = dialect.MAVLink(None)
        parser.robust_parsing = True
        kinds = set()
        client.setblocking(False)
        try:
            while True:
                kinds |= {m.get_type() for m in parser.parse_buffer(client.recv(65536)) or ()}
        except BlockingIOError:
            pass
    assert "HEARTBEAT" in kinds


@pytest.mark.parametrize("link", ["udpout:127.0.0.1", "nonsense", "flight.tlog"])
def test_bad_links_are_one_line(link, capsys):
    assert run("sitl", "autopilot", "--link", link, "--for-s", "0.1") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_run_is_never_written_over_without_being_asked(short, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert run("sim", short(), "--geometry") == 0
    assert {p.name for p in (tmp_path / "runs").iterdir()} == {"sim-default-0", "sim-default-0-2"}


def test_the_last_line_is_the_verdict(short, tmp_path, capsys):
    run("sim", short(), "--geometry", "--out", tmp_path / "a")
    assert "PASSED: 1 of 1 criteria are met" in capsys.readouterr().out
    only_pixels = [{"metric": "lock_share", "min": 0.5, "when": "pixels"}]
    assert run("sim", short(criteria=only_pixels), "--geometry", "--out", tmp_path / "b") == 1
    assert "FAILED: the scenario has no criterion for this kind of run" in capsys.readouterr().out


def test_a_recording_that_fails_does_not_stop_the_flight_and_is_said(short, tmp_path, monkeypatch, capsys):
    from uavfollow.mavlink.tlog import TlogError, TlogWriter

    def full(self, *_):
        raise TlogError("no space left on device")

    monkeypatch.setattr(TlogWriter, "write", full)
    assert run("sim", short(), "--geometry", "--out", tmp_path / "out") == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("uavfollow: error")]
    assert len(error) == 1
    assert "link.tlog" in error[0]
    assert not (tmp_path / "out").exists()


def test_an_interrupted_run_is_kept_and_has_not_passed(short, tmp_path, monkeypatch, capsys):
    from uavfollow.sim.files import SimFiles

    add, calls = SimFiles.add, []

    def interrupting(self, step, begin_s):
        calls.append(step)
        if len(calls) == 20:
            raise KeyboardInterrupt
        add(self, step, begin_s)

    monkeypatch.setattr(SimFiles, "add", interrupting)
    assert run("sim", short(), "--geometry", "--out", tmp_path / "out") == 130
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (told["interrupted"], told["passed"]) == (True, False)
    assert told["flown_s"] < told["duration_s"]
    assert "INTERRUPTED" in capsys.readouterr().out
