"""What things are (parts, sizes, colours, joints) and what can be read of them, a file a kind.

Descriptions are numpy alone; `hide_tasks.bullet` gives them bodies.
"""
