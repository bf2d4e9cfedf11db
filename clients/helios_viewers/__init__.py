"""Live viewers: the bus or a recording as channels in Foxglove and Rerun.

view.py             runs a source and its sinks until it is stopped
live_source.py      entries from the bus
recorded_source.py  entries of a recording, by log time
playback.py         pace, pause and seek of a recording
foxglove_sink.py    entries to the WebSocket server of the Foxglove SDK
rerun_sink.py       entries to Rerun: its server with a web page, or a file
rerun_entities.py   pure: one entry to Rerun's entities
rerun_grids.py      pure: grids and point clouds
rerun_scenes.py     pure: boxes, spheres, lines and arrows of scenes
rerun_texts.py      pure: tasks and decisions as text
rerun_layout.py     the layout of Rerun's viewer
"""
