"""A node as a process: executor, signals, exit codes."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from tbm_msgs_py.nodes.logs import get_logger
from tbm_msgs_py.nodes.transport import avoid_shared_memory

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode

# A bounded wait: `EventsExecutor.spin()` without one can turn in place and hold the interpreter.
WAIT = 1.0  # s
AGAIN = 0.25  # s
_ENDING = (signal.SIGINT, signal.SIGTERM)


def run_node(factory: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until it ends or a signal comes, never with a traceback.

    Parameters
    ----------
    factory : callable
        Creates the node, after ROS has been initialised.
    args : sequence of str, optional
        Command line with the program name first; default `sys.argv`.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM or the node's own end, 2 for bad arguments or parameters, 1 for a failure.
    """
    node: ManagedNode | None = None
    code = 0
    try:
        # Before rclpy.init: rclpy's own handlers, which end the context, call the ones they find.
        sys.unraisablehook = _without_interruptions
        _Signal.came, _Signal.breaks_off = False, True
        _handle(_on_signal)
        avoid_shared_memory()
        rclpy.init(args=None if args is None else list(args))
        node = factory()
        code = _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        _Signal.breaks_off = False
    except Exception as error:  # noqa: BLE001  the last resort before a traceback
        _Signal.breaks_off = False  # before any call: a signal that broke rclpy may be about to raise, too
        code = _explain(error, node)
    finally:
        _Signal.breaks_off = False
        _close(node)
    # An interruption that passes an `exec` of text, as there are in many an import, is noted by Python, and a process
    # started with -m dies of SIGINT at its end. The next text clears the note.
    exec("")  # noqa: S102
    return code or (node.exit_code if node else 0)  # its end may have gone wrong, too


def _handle(handler: Any) -> None:
    if threading.current_thread() is threading.main_thread():
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number in (*_ENDING, signal.SIGALRM):
            signal.signal(number, handler)


def _without_interruptions(unraisable: Any) -> None:
    """Say nothing of an interruption that a library's callback has swallowed: it comes again."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)


class _Signal:
    """A signal that ends the process."""

    breaks_off = False  # raises where the program stands: while a node starts
    came = False


def _on_signal(_number: int, _frame: Any) -> None:
    """Break off a start that takes long; while spinning the end of the context is enough.

    The executor would log a `KeyboardInterrupt` in a callback as a fault.
    """
    _Signal.came = True
    if _Signal.breaks_off:
        # A compiler's callback swallows what is raised in it: again, until it is heard.
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
        raise KeyboardInterrupt


def _spin(node: ManagedNode) -> int:
    executor = fastest_executor()
    executor.add_node(node)
    try:
        if not node.start():
            return 2 if node.context.ok() else node.exit_code
        _Signal.breaks_off = False
        while not node.ended.done() and node.context.ok():
            _turn(executor, node)
    finally:
        executor.remove_node(node)
        executor.shutdown()
    return node.exit_code


def _turn(executor: Any, node: ManagedNode) -> None:
    """Work for a while, until the node's end at most."""
    with suppress(InvalidHandle):  # an event that waited for what a callback has destroyed: the events executor's own
        if isinstance(executor, SingleThreadedExecutor):
            executor.spin_once(timeout_sec=WAIT)  # the other leaves a callback at the future for each that it has run
        else:
            executor.spin_until_future_complete(node.ended, timeout_sec=WAIT)


def fastest_executor() -> Any:
    """Events executor where this rclpy has it: half the CPU, no losses at high rates."""
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def _explain(error: Exception, node: ManagedNode | None) -> int:
    """Exit code for an error, with its one line; an error after a signal or without the context is part of the end."""
    if node is None and _Signal.came:
        return 0
    if node is not None and not node.context.ok():
        return node.exit_code
    logger = node.get_logger() if node else get_logger("tbm_monitor")
    message = " ".join(str(error).split())
    if node is None and isinstance(error, ValueError | RuntimeError | ParameterException):
        logger.fatal(message)
        return 2
    logger.fatal(f"{type(error).__name__}: {message}")
    logger.debug(traceback.format_exc())
    return 1


def _close(node: ManagedNode | None) -> None:
    """Release the node's resources; a second signal meanwhile changes nothing."""
    _handle(signal.SIG_IGN)
    if node is not None:
        node.finish()
        node.destroy_node()
    rclpy.try_shutdown()
