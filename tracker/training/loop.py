"""The training run: stages, steps, checkpoints, validation and reports, resumable at exactly the next step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import nn

from tracker.training.budget import steps_of
from tracker.training.checkpoint import (
    BEST,
    LAST,
    Checkpoint,
    Position,
    State,
    from_bytes,
    has_checkpoint,
    read_bytes,
    read_checkpoint,
    read_recipe,
    recipe_of,
    to_bytes,
    write_checkpoint,
    write_recipe,
)
from tracker.training.curves import Curves
from tracker.training.distributed import World
from tracker.training.errors import TrainingError
from tracker.training.export import BEST_WEIGHTS, WEIGHTS, Made, describe_start, export
from tracker.training.loader import load
from tracker.training.progress import Outcome, Progress
from tracker.training.recipe import Recipe, Stage
from tracker.training.reporter import Reporter
from tracker.training.schedule import rate_at
from tracker.training.sources.packed import without_places
from tracker.training.step import Learner, Step
from tracker.training.teacher import Teacher
from tracker.training.types import Batch, Batches, Footage
from tracker.training.validate import SETTINGS, Tracks, Validated, evaluation_copy, validate
from tracker.weights.store import SUFFIX

MAX_SKIPPED_IN_A_ROW = 50  # so many bad batches are no accident: the weights or the data are ruined


@dataclass(slots=True)
class _Session:
    """What `run` was given, the time of its clock, and the run's own time at the last checkpoint."""

    should_stop: Callable[[], bool]
    clock: Callable[[], float]
    now_s: float
    saved_s: float
    reporter: Reporter


class Trainer:
    """Trains `network` by `recipe` in `folder`, which must exist.

    With `resume` it goes on from `last.ckpt` where there is one; without it none may be there.

    `batches_for(stage)` makes the batches of a stage, of which every process of `world` gets its rows. `footage` is
    validated on by process 0. `workers`: processes that make batches. `teacher`: see `Teacher`; None without one.
    """

    def __init__(
        self,
        recipe: Recipe,
        network: nn.Module,
        batches_for: Callable[[int], Batches],
        folder: Path,
        *,
        device: torch.device,
        world: World,
        footage: Sequence[Footage] = (),
        workers: int = 0,
        teacher: Teacher | None = None,
        resume: bool = False,
    ) -> None:
        self._recipe = recipe
        self._resumes = resume
        self._batches_for = batches_for
        self._folder = folder
        self._world = world
        self._footage = footage
        self._validates = False
        self._workers = workers
        self._start = describe_start(recipe.start)  # now: the file may be gone in ten hours
        self._learner = Learner(recipe, network, device, world, teacher)
        self._device = device
        self._curves = Curves(folder)
        self._position = Position()
        self._optimiser_state: State | None = None
        self._notes: list[str] = []

    def run(
        self, should_stop: Callable[[], bool], clock: Callable[[], float], report: Callable[[Progress], None]
    ) -> Outcome:
        """Train to the end or until `should_stop`, which is asked before every step and frame of validation.

        `clock` gives monotonic seconds. Either way the state is saved and the weights exported.
        Raises TrainingError: damaged or foreign checkpoint, no data, disk, memory, another process that ended, or too
        many skipped steps in a row.
        """
        self._resume()
        # Agreed, because it takes all processes: those that do not lead need not have opened the footage.
        self._validates = self._world.highest([float(bool(self._footage))])[0] > 0
        reporter = Reporter(self._recipe, self._curves, self._position, report if self._world.leads else None)
        session = _Session(should_stop, clock, clock(), self._position.total_s, reporter)
        with _denormals_flushed():
            finished = self._all_stages(session) and self._final_validation(session)
        if not finished:
            self._save(session)
        files = self._export(session) if self._world.leads else ()
        self._world.wait()
        at = self._position
        told = (at.unused, tuple(at.validations), files, tuple(self._notes))
        return Outcome(finished, at.pairs, at.total_s, at.skipped_steps, *told)

    def _resume(self) -> None:
        path = self._folder / LAST
        data = self._world.led(self._found)
        if data is not None:
            self._take_over(from_bytes(data, path), path)
        if self._world.leads:
            write_recipe(self._folder, self._recipe)
            self._notes += self._curves.cut(self._position.pairs, self._position.validations)

    def _found(self) -> bytes | None:
        """The checkpoint to go on from, as it lies there; None: from the beginning."""
        path = self._folder / LAST
        if not has_checkpoint(self._folder):
            return None
        if not self._resumes:
            raise TrainingError(f"{path}: a run lies there; resume it, or choose another folder")
        data = read_bytes(path)
        # One from before checkpoints held it has only the file beside it to tell its recipe.
        if from_bytes(data, path).recipe is None and not _is_same(read_recipe(self._folder), self._recipe):
            raise TrainingError(_of_another_recipe(path))
        return data

    def _take_over(self, checkpoint: Checkpoint, path: Path) -> None:
        if checkpoint.recipe is not None and not _is_of(checkpoint.recipe, self._recipe):
            raise TrainingError(_of_another_recipe(path))
        if checkpoint.position.stage > len(self._recipe.stages):
            raise TrainingError(f"{path}: is of a recipe with more stages; resume it with its own recipe")
        try:
            self._learner.load(checkpoint.network, checkpoint.average, checkpoint.scaler)
        except (RuntimeError, KeyError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise TrainingError(f"{path}: is of another network ({reason}); resume it with its own recipe") from error
        self._position, self._optimiser_state = checkpoint.position, checkpoint.optimiser

    def _all_stages(self, session: _Session) -> bool:
        """Whether they are done; False when it was stopped."""
        while self._position.stage < len(self._recipe.stages):
            if not self._stage(session):
                return False
            self._position.stage += 1
            self._position.step, self._position.stage_s = 0, 0.0
            self._optimiser_state = None
            self._save(session)
        return True

    def _stage(self, session: _Session) -> bool:
        at = self._position
        stage = self._recipe.stages[at.stage]
        self._learner.begin(at.stage, self._optimiser_state)
        steps = steps_of(stage)
        batches = load(self._batches_for(at.stage), at.step, None if steps is None else steps - at.step, self._workers)
        try:
            while steps is None or at.step < steps:
                stopped = self._agreed_stop(session)
                if not stopped and self._validation_is_due():
                    if self._validate(session):
                        continue  # to agree on the time anew
                    stopped = True
                if stopped:
                    self._optimiser_state = self._learner.optimiser_state()
                    return False
                # Only here, where all processes have agreed on the time: one that left alone would leave them waiting.
                if steps is None and self._clock_says_over(stage):
                    break
                self._one_step(session, stage, steps, batches)
            return True
        finally:
            if hasattr(batches, "close"):
                batches.close()

    def _clock_says_over(self, stage: Stage) -> bool:
        return self._position.stage_s >= 60.0 * (stage.minutes or 0.0)

    def _agreed_stop(self, session: _Session) -> bool:
        """Let the clock of the stage go on; all processes agree on it, as the learning rate follows from it."""
        self._tick(session)
        at = self._position
        stop, at.stage_s, at.total_s = self._world.highest([float(session.should_stop()), at.stage_s, at.total_s])
        return stop > 0

    def _tick(self, session: _Session, of_stage: bool = True) -> float:
        now = session.clock()
        passed = max(0.0, now - session.now_s)
        session.now_s = now
        self._position.stage_s += passed if of_stage else 0.0
        self._position.total_s += passed
        return passed

    def _one_step(self, session: _Session, stage: Stage, steps: int | None, batches: Iterator[Batch]) -> None:
        at = self._position
        progress = at.step / steps if steps is not None else at.stage_s / (60.0 * (stage.minutes or 1.0))
        rate = rate_at(stage, min(progress, 1.0), at.step * stage.batch)
        batch = next(batches, None)
        if batch is None:
            raise TrainingError(f"stage {at.stage + 1} has no batch {at.step}: its batches ended too early")
        result = self._learner.learn(batch, at.step, rate)
        at.step += 1
        at.pairs += stage.batch
        at.unused.merge(batch.skipped)
        passed = self._tick(session)
        at.training_s += passed
        self._count(result)
        session.reporter.step(None if result.skipped else result.losses, rate, passed)
        if at.total_s - session.saved_s >= 60.0 * self._recipe.checkpoint_minutes:
            self._optimiser_state = self._learner.optimiser_state()
            self._save(session)
            self._draw(session)

    def _count(self, result: Step) -> None:
        at = self._position
        if not result.skipped:
            at.in_a_row = 0
            return
        at.skipped_steps += 1
        at.in_a_row += 1
        if at.in_a_row >= MAX_SKIPPED_IN_A_ROW:
            raise TrainingError(
                f"stage {at.stage + 1}, step {at.step}: {at.in_a_row} steps in a row had a loss or gradient that is "
                f"not finite or above {self._recipe.optimiser.max_loss:g} and were skipped; the checkpoints in "
                f"{self._folder} are kept: resume with a lower lr or clip, or look at the data (train preview)"
            )

    def _validation_is_due(self) -> bool:
        at = self._position
        return self._validates and at.pairs - at.validated_at >= self._recipe.validation.every_pairs

    def _final_validation(self, session: _Session) -> bool:
        at = self._position
        known = bool(at.validations) and at.validated_at == at.pairs
        return not self._validates or known or self._validate(session)

    def _validate(self, session: _Session) -> bool:
        """Process 0 validates, the others wait to hear whether it was stopped."""
        validated = None
        if self._world.leads:
            session.reporter.say("validating")
            network = evaluation_copy(self._learner.network, self._learner.average.tensors())
            tracks = Tracks.of(self._recipe.validation)
            scores = validate(network, self._footage, SETTINGS, tracks, session.should_stop)
            torch.set_flush_denormal(True)  # the engine ends with it off
            self._tick(session, of_stage=False)  # a validation must not eat up the end of a stage's curve
            if scores is not None:
                validated = Validated(self._position.pairs, self._position.total_s / 60, scores)
                self._curves.add_validation(validated.pairs, validated.minutes, scores)
        done = self._world.highest([float(validated is not None)])[0] > 0
        at = self._position
        if done:
            at.validations.append(validated or Validated(at.pairs, at.total_s / 60, ()))
            self._optimiser_state = self._learner.optimiser_state() if at.step else None
            self._save(session, best=validated is not None and at.best is validated)
        return done

    def _save(self, session: _Session, best: bool = False) -> None:
        session.saved_s = self._position.total_s
        session.reporter.row()
        if not self._world.leads:
            return
        learner = self._learner
        state = (learner.network.state_dict(), learner.average.state_dict(), self._optimiser_state)
        data = to_bytes(Checkpoint(self._position, *state, learner.scaler_state(), self._recipe.model_dump_json()))
        # The best first: a crash between the two leaves a run that validates again, not one without its best weights.
        if best:
            write_checkpoint(self._folder / BEST, data)
        write_checkpoint(self._folder / LAST, data)

    def _draw(self, session: _Session) -> Path | None:
        """A picture is a luxury: whatever keeps it from being drawn does not end a run."""
        if not self._world.leads:
            return None
        try:
            return self._curves.draw()
        except Exception as error:  # those of matplotlib are of any kind
            reason = (str(error).splitlines() or [""])[0]
            self._note(session, f"the curves were not drawn ({type(error).__name__}: {reason})")
            return None

    def _note(self, session: _Session, text: str) -> None:
        if text not in self._notes:
            self._notes.append(text)
            session.reporter.say(text)

    def _export(self, session: _Session) -> tuple[Path, ...]:
        """The average of now, and that of the best validation where it is another one."""
        at = self._position
        made = Made(self._recipe, self._start, at, self._device, self._world.size)
        files = list(export(self._folder, WEIGHTS, self._learner.average.tensors(), made))
        best = at.best
        if best is not None and best.pairs != at.pairs and (self._folder / BEST).is_file():
            try:
                kept = read_checkpoint(self._folder / BEST)
            except TrainingError:
                self._note(session, f"{BEST} is damaged, {BEST_WEIGHTS}{SUFFIX} was not made")
            else:
                files += export(self._folder, BEST_WEIGHTS, kept.average, replace(made, position=kept.position))
        picture = self._draw(session)
        return (*files, *([picture] if picture else []))


def _is_same(then: Recipe | None, now: Recipe) -> bool:
    return then is not None and without_places(then) == without_places(now)


def _is_of(text: str, recipe: Recipe) -> bool:
    try:
        return _is_same(recipe_of(text), recipe)
    except ValueError:  # of another version
        return False


def _of_another_recipe(path: Path) -> str:
    return f"{path}: is of another recipe; resume it with its own recipe, or choose another folder"


@contextmanager
def _denormals_flushed() -> Iterator[None]:
    """Denormals slow training down many times. The switch is the processor's and must not stay on for others."""
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
