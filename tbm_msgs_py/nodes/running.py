"""A node as a process: executor, signals, exit codes."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.log_folder import settle_log_folder
from tbm_msgs_py.nodes.logs import get_logger
from tbm_msgs_py.nodes.parameter_file import NodeArguments
from tbm_msgs_py.nodes.processes import StartInterruption, handle_node_signals
from tbm_msgs_py.nodes.transport import avoid_shared_memory

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode

# A bounded wait: `EventsExecutor.spin()` without one can turn in place and hold the interpreter.
WAIT = 1.0  # s


def run_node(factory: Callable[[], ManagedNode[Any]], args: Sequence[str] | None = None) -> int:
    """Run a node until it ends or gets a signal, never with a traceback.

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
    arguments = list(sys.argv if args is None else args)
    node: ManagedNode[Any] | None = None
    code = 0
    try:
        StartInterruption.begin()
        avoid_shared_memory()
        stated = NodeArguments(arguments)
        moved = settle_log_folder()
        rclpy.init(args=arguments)
        if moved:
            get_logger("tbm_monitor").warning(moved)
        node = factory()
        stated.check(node.get_fully_qualified_name(), node.executable)
        code = _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        StartInterruption.breaks_off = False
    except Exception as error:  # noqa: BLE001  the last resort before a traceback
        StartInterruption.breaks_off = False  # before any call: a signal that broke rclpy may be about to raise, too
        code = _explain(error, node)
    finally:
        StartInterruption.breaks_off = False
        _close(node)
    # An interruption that passes an `exec` of text, as there are in many an import, is noted by Python, and a process
    # started with -m dies of SIGINT at its end. The next text clears the note.
    exec("")  # noqa: S102
    return code or (node.exit_code if node else 0)  # its end may have gone wrong, too


def _spin(node: ManagedNode[Any]) -> int:
    executor = fastest_executor()
    executor.add_node(node)
    try:
        if not node.start():
            return 2 if node.context.ok() else node.exit_code
        StartInterruption.breaks_off = False
        while not node.ended.done() and node.context.ok():
            _turn(executor, node)
    finally:
        executor.remove_node(node)
        executor.shutdown()
    return node.exit_code


def _turn(executor: Executor, node: ManagedNode[Any]) -> None:
    """Work for a while, until the node's end at most."""
    with suppress(InvalidHandle):  # an event that waited for what a callback has destroyed: the events executor's own
        if isinstance(executor, SingleThreadedExecutor):
            executor.spin_once(timeout_sec=WAIT)  # the other leaves a callback at the future for each that it has run
        else:
            executor.spin_until_future_complete(node.ended, timeout_sec=WAIT)


def fastest_executor() -> Executor:
    """Events executor where this rclpy has it: half the CPU, no losses at high rates."""
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def _explain(error: Exception, node: ManagedNode[Any] | None) -> int:
    """Exit code for an error, with its one line; an error after a signal or without the context is part of the end."""
    if node is None and StartInterruption.received:
        return 0
    if node is not None and not node.context.ok():
        return node.exit_code
    logger = node.get_logger() if node else get_logger("tbm_monitor")
    message = " ".join(str(error).split())
    if isinstance(error, InputError) or (node is None and isinstance(error, RuntimeError | ParameterException)):
        logger.fatal(message)
        return 2
    logger.fatal(f"{type(error).__name__}: {message}")
    logger.debug(traceback.format_exc())
    return 1


def _close(node: ManagedNode[Any] | None) -> None:
    """Release the node's resources; a second signal meanwhile changes nothing."""
    handle_node_signals(signal.SIG_IGN)
    if node is not None:
        node.finish()
        node.destroy_node()
    rclpy.try_shutdown()
