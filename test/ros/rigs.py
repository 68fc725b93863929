"""Publishers of others: each a node in a context, and so a participant, of its own, as another process would be."""

from contextlib import AbstractContextManager

import rclpy


class Rig(AbstractContextManager):
    """A publisher that nobody spins, in no namespace; gone after `close` or the end of its `with`."""

    def __init__(self, kind, topic, profile, name="rig"):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node(name, context=self._context)
        self._publisher = self._node.create_publisher(kind, topic, profile)
        self.publish = self._publisher.publish

    @property
    def matched(self):
        """Subscriptions that it has."""
        return self._publisher.get_subscription_count()

    def close(self):
        self._node.destroy_node()
        self._context.try_shutdown()

    def __exit__(self, *_):
        self.close()
