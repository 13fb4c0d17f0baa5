"""The subcommands, one module each.

Each module has DESCRIPTION, EXAMPLES, `add_arguments`, and `run`, which returns the exit code, or
None for 0. Read `aspects.py` first.
"""

ROS = 'ROS 2: nodes and their logs'
# The help of each, by group, in the order of the list. Only the module of the requested one is
# imported.
GROUPS = {
    'in the browser': {'studio': 'open a page in the browser: drop a CAD file, see how it lies'},
    'how a part comes to rest': {
        'drop': 'drop a part and show how it comes to rest',
        'reorient': 'show how an action brings a part from aspect to aspect',
        'retention': 'show how strong a disturbance makes a part leave each aspect',
        'study': 'show how the aspects depend on the conditions, over many points',
        'optimise': 'find the conditions with the most of the wanted aspects',
        'calibrate': 'find restitution and friction of a surface from counts by hand',
    },
    'what its shape tells, without drops': {
        'aspects': 'show the aspects of a part, without drops',
        'estimate': 'predict the distribution from the shape, without drops',
        'outlines': 'show and export what a camera above sees of each aspect',
        'identify': 'tell from an outline in which aspect a part lies',
    },
    'feeders': {
        'forecast': 'predict the parts per minute of a feeder with camera and robot',
        'track': 'tell what passes the traps of a bowl or linear feeder',
        'drift': 'test whether counted parts still agree with the simulation',
    },
    'results': {
        'report': 'write a page with pictures and charts of a result',
        'compare': 'compare two distributions, or one with a count by hand',
        'classify': 'sort resting poses from a file into aspects',
    },
    ROS: {
        'demo': 'drop l_bracket 1000 times over ROS and show the result',
        'feeder_demo': 'run a simulated vision feeder over ROS, beside its forecast',
        'nodes': 'run all ROS nodes in one process',
        'request': 'ask the running ROS nodes for a distribution',
        'info': 'show what is in a log',
        'replay': 'publish a log again on the same topics',
        'recover': 'close logs that a crash left unfinished',
    },
}
COMMANDS = {name: text for group in GROUPS.values() for name, text in group.items()}
