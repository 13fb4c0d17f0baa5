"""Names of the choices and results in the messages of a feeder."""

from resting_aspects_interfaces.msg import FeederAdvice, PickResult

CHOICES = {
    FeederAdvice.WAIT: 'wait',
    FeederAdvice.PICK: 'pick',
    FeederAdvice.FLIP: 'flip',
    FeederAdvice.SPREAD: 'spread',
    FeederAdvice.SUPPLY: 'supply',
}
RESULTS = {
    PickResult.PICKED: 'picked',
    PickResult.MISSED: 'missed',
    PickResult.DROPPED: 'dropped',
    PickResult.MOVED: 'moved',
}
