"""What reader.py and vector.py share: broken rules, types of nodes."""

UNCOVERED = 0xFFFFFFFF
NONE, LEAF, INNER, EMPTY = range(4)


class Broken(Exception):
    """A rule that the file breaks."""

    def __init__(self, rule, where, detail):
        super().__init__(f"{rule}: {where}: {detail}")
        self.rule, self.where, self.detail = rule, where, detail


def need(good, rule, where, detail=""):
    if not good:
        raise Broken(rule, where, detail)
