"""Ctrl-C ends long calls, and other threads run meanwhile."""

import os
import signal
import threading
import time
import unittest

import numpy as np

import cotwin
from support import SOURCE, Case, Q0, Q1, arm

EXAMPLE = SOURCE / "examples/02_free_motion_lwr4/twin.ssd"


class Interrupted(Case):
    """A call that would last minutes, and a signal after a moment: a call that did not end would end at CTest's time limit."""

    def interrupt(self, call):
        timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        try:
            with self.assertRaises(KeyboardInterrupt):
                call()
                time.sleep(60)  # the call ended by itself: too early for this test
        finally:
            timer.cancel()
            timer.join()

    def test_a_run_ends_and_keeps_its_rows(self):
        simulation = cotwin.Simulation(EXAMPLE, stop=1e5, results=self.folder, keep=False)
        self.interrupt(simulation.run)
        time_reached = simulation.time
        self.assertGreater(time_reached, 0)
        self.assertLess(time_reached, 1e5)
        recording = cotwin.Recording.load(self.folder)
        self.assertGreater(len(recording), 1)
        self.assertFalse(simulation.step())

    def test_run_to_ends_and_can_go_on(self):
        simulation = cotwin.Simulation(EXAMPLE, stop=1e5, keep=False)
        self.interrupt(lambda: simulation.run_to(9e4))
        reached = simulation.time
        self.assertTrue(simulation.step())
        self.assertAlmostEqual(simulation.time, reached + 0.001, places=9)

    def test_a_run_on_the_wall_clock_ends(self):
        simulation = cotwin.Simulation(arm(stop=1000, clock="wall"), keep=False)
        self.interrupt(simulation.run)

    def test_a_unit_in_python_ends(self):
        class Busy(cotwin.Unit):
            def declare(self):
                self.output("y")

            def step(self, t, h):
                time.sleep(0.001)

        simulation = cotwin.Simulation(cotwin.Scenario(stop=1000).add("busy", Busy), keep=False)
        self.interrupt(simulation.run)

    def test_a_batch_ends(self):
        arm = cotwin.Robot("lwr4")
        q = np.zeros((20000, 7))

        def call():
            for _ in range(100000):
                arm.regressor(q, q, q)

        self.interrupt(call)

    def test_an_excitation_ends(self):
        self.interrupt(lambda: cotwin.excite("lwr4", rounds=1000000))

    def test_a_search_ends(self):
        request = {"service": "optimise", "from_q_rad": Q0, "to_q_rad": Q1, "T_min_s": 2.0, "rounds": 20000, "particles": 200}
        self.interrupt(lambda: cotwin.ask(request, threads=1))

    def test_a_handler_that_raises_ends_a_run_with_its_exception(self):
        class Alarm(Exception):
            pass

        def handler(*_):
            raise Alarm

        before = signal.signal(signal.SIGALRM, handler)
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.2)
            with self.assertRaises(Alarm):
                cotwin.run(EXAMPLE, stop=1e5, keep=False)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


class Released(Case):
    def test_other_threads_run_during_a_run(self):
        # A thread that needs the GIL ends a run that waits for nothing else: it would never end if the run kept the GIL.
        simulation = cotwin.Simulation(EXAMPLE, stop=1e5, keep=False)
        done = threading.Event()

        class Stop(Exception):
            pass

        def handler(*_):
            if done.is_set():
                raise Stop

        before = signal.signal(signal.SIGALRM, handler)
        counted = 0

        def count():
            nonlocal counted
            for _ in range(1000):
                counted += 1
            done.set()

        thread = threading.Timer(0.05, count)
        thread.start()
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.1, 0.1)
            with self.assertRaises(Stop):
                simulation.run()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
            thread.join()
        self.assertEqual(counted, 1000)


if __name__ == "__main__":
    unittest.main()
