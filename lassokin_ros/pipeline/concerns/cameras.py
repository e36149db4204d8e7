"""The concerns about several cameras, or one in a fixed frame: silent, late, without a pose, or wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lassokin_ros.pipeline.concerns.catalogue import Raised, say
from lassokin_ros.pipeline.session import Session

SILENCE_S = 2.0
"""s: a longer period without keypoints is a warning."""
APART_S = 0.06
"""s: difference of the delays of two cameras that is a warning. Prediction over it costs a quarter of the accuracy."""


def wrong_cameras(session: Session, learned: bool = True) -> Iterator[Raised]:
    """Yield which cameras are wrong, as the person shows: they contradict the others, or their poses are off.

    learned: also yield poses whose error is small enough to be learned, unless the set-up is wrong.
    """
    agreement, extrinsics = session.placement.agreement, session.roster.extrinsics
    words = [*agreement.left_out.values(), *agreement.same_keypoints()]
    words += [] if any(agreement.same_keypoints()) else session.placement.rig.set_up
    if learned and not words and extrinsics is not None:
        poses = [extrinsics.in_words(name) for name in session.cameras]
        words += filter(None, [extrinsics.lately.in_words] if extrinsics.lately.in_words else poses)
    return (say("camera_wrong", fault=fault) for fault in words)


def camera_concerns(session: Session, sending: Sequence[str], silent_s: Callable[[str], float]) -> Iterator[Raised]:
    """Yield what is wrong. sending: cameras with messages in the last period. silent_s: returns s without messages."""
    if session.placement.places is None:
        return
    for fault in session.placement.places.faults.values():
        yield say("camera_unplaced", fault=fault)
    yield from _stamps_against_tf(session)
    if len(session.cameras) == 1:
        return
    if shared := session.placement.places.shared_frame:
        yield say("cameras_share_frame", fault=shared)
    silent = session.config.silent_when_empty and session.scene.detector_connected
    for name, camera in session.cameras.items():
        if camera.camera.view is None:
            yield say("camera_without_info", camera=name)
        elif not silent and silent_s(name) > SILENCE_S:
            yield say("camera_silent", camera=name, limit=SILENCE_S)
    yield from _clocks(session, sending)
    for fault in session.placement.rig.clocks:
        yield say("camera_clock", fault=fault)
    yield from wrong_cameras(session)


def _stamps_against_tf(session: Session) -> Iterator[Raised]:
    """Yield which cameras' stamps do not fit TF."""
    offset = session.placement.tf_offset
    for name in session.cameras:
        if offset is not None and (found := offset.clear(name)):
            seconds, deviation = found
            camera, way = f" '{name}'" if name else "", "late" if seconds > 0 else "early"
            yield say("tf_clock", camera=camera, ms=1e3 * abs(seconds), deviation=1e3 * deviation, way=way)


def no_usable_image(session: Session, sending: Sequence[str]) -> Iterator[Raised]:
    """Yield why no camera that sends keypoints can be used."""
    places = session.placement.places
    if places is not None and sending and all(name in places.faults for name in sending) and places.fault:
        yield say("no_usable_image", fault=places.fault)


def _clocks(session: Session, sending: Sequence[str]) -> Iterator[Raised]:
    """Yield that the stamps of two cameras are of different clocks, or one of the detectors is slower."""
    cameras = ((name, session.cameras[name]) for name in sending)
    delays = {name: camera.delay_s for name, camera in cameras if camera.delay_s is not None}
    if len(delays) < 2:
        return
    first, last = min(delays, key=delays.__getitem__), max(delays, key=delays.__getitem__)
    if (apart := delays[last] - delays[first]) > APART_S:
        yield say("camera_late", last=last, first=first, apart=apart)
