"""What must hold of every robot driver, as a suite of tests (`docs/tutorials/your-own-robot.md`).

On one's own driver, from the shell:

    python -m helios_contract my_package:MyRobot

or among one's own tests:

    from helios_contract.rig import Rig
    from helios_contract.suite import DriverContract

    class TestMyRobot(DriverContract):
        @classmethod
        @contextmanager
        def stand(cls):
            yield Rig(MyRobot())
"""
