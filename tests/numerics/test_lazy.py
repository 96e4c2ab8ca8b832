"""Attributes that are computed at first use."""

import threading

from mbdcasadi.numerics.lazy import cached_property


class Thing:
    def __init__(self, compute):
        self.compute = compute

    @cached_property
    def value(self):
        """Whatever is computed."""
        return self.compute()


def test_a_value_is_computed_once():
    asked = []
    thing = Thing(lambda: asked.append(1) or 3)
    assert thing.value == thing.value == 3 and len(asked) == 1
    assert Thing.value.__doc__ == "Whatever is computed."


def test_one_instance_does_not_wait_for_another():
    """A thread that computes a value and waits for a lock does not stop the one that holds this lock."""
    lock, inside = threading.Lock(), threading.Event()

    def waits():
        inside.set()
        with lock:
            return 1

    with lock:
        thread = threading.Thread(target=lambda: Thing(waits).value, daemon=True)
        thread.start()
        assert inside.wait(10)
        found = []
        other = threading.Thread(target=lambda: found.append(Thing(lambda: 2).value), daemon=True)
        other.start()
        other.join(10)
        assert found == [2]
    thread.join(10)
    assert not thread.is_alive()
