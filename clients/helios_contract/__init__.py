"""Contract tests for robot drivers, detectors and scorers (`docs/tutorials/your-own-robot.md`).

For your driver, from the shell:

    python -m helios_contract my_package:MyRobot

or among your tests:

    from helios_contract.rig import Rig
    from helios_contract.suite import DriverContract

    class TestMyRobot(DriverContract):
        @classmethod
        @contextmanager
        def stand(cls):
            yield Rig(MyRobot())
"""
