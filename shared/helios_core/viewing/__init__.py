"""Messages of the bus as channels that viewers draw: for recordings and for live viewers.

bus_messages.py     subscribes every topic, and polls the maps after each change
map_polling.py      one thread that polls the maps and records the replies
poll_times.py       when each map is polled
newest_map.py       requests of the newest 2D map, and what takes its place once it is gone
message_queue.py    bounded queue between the bus and a slow reader
message_entries.py  one bus message to its entries: images, transforms, log
map_entries.py      the maps to grids, point clouds and scenes
gaussian_cloud.py   the Gaussians of the object map to a point cloud
plan_entries.py     plans and decisions to scenes
foxglove_scene.py   parts of a scene
channel_schema.py   schemas of the messages
"""
