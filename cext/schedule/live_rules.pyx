# cython: freethreading_compatible=True
"""Rules between live parameters (graph/rules.py): which requests obey them, and how ramps keep them.

Values and targets obey all rules. The rules are linear, so every point on the straight line from the present values to
the targets obeys them, too. Where the ramps of a group would break a rule in the next tick, the group moves along that
line, each parameter at most at its slew. At least one moves at its slew in each tick, so all targets are reached. What
rounding would break is held back; where nothing could move then, the rules hold to rounding.
"""

from libc.math cimport fabs, fmin
from libc.stdlib cimport calloc, free

from cext.ring.mailbox cimport Letter

cdef double ROUNDING = 1e-9     # share of the sum of magnitudes


cdef class LiveRules:
    """Rules of a schedule.

    entries : cext.rules.LiveRule of each
    count : number of live parameters
    """

    def __init__(self, entries, int count):
        cdef LiveRule *rule
        cdef int place = 0
        self.entries, self.count, self.parameter_count = list(entries), len(entries), count
        sides = [entry.rule.ascending for entry in entries]
        self.values = <double *>calloc(max(1, count), sizeof(double))
        self.rules = <LiveRule *>calloc(max(1, self.count), sizeof(LiveRule))
        self.terms = <Term *>calloc(1 + sum(len(side.terms) for pair in sides for side in pair), sizeof(Term))
        groups = self.groups()
        for index, (small, large) in enumerate(sides):
            rule = &self.rules[index]
            rule.first, rule.middle = place, place + len(small.terms)
            for parameter, factor in (*small.terms, *large.terms):
                self.terms[place].parameter, self.terms[place].factor = parameter, factor
                rule.group = groups[parameter]
                place += 1
            rule.last = place
            rule.small, rule.large, rule.strict = small.constant, large.constant, entries[index].rule.strict

    def __dealloc__(self):
        free(self.rules)
        free(self.terms)
        free(self.values)

    cdef list groups(self):
        """Return the group of each parameter, -1 without a rule."""
        groups = list(range(self.parameter_count))
        related = set()
        for entry in self.entries:
            related.update(entry.rule.keys)
            joined = {groups[key] for key in entry.rule.keys}
            groups = [min(joined) if group in joined else group for group in groups]
        return [group if index in related else -1 for index, group in enumerate(groups)]

    def check(self, targets) -> None:
        """Raise ValueError for targets of all parameters that break a rule."""
        for entry in self.entries:
            if not entry.rule.holds(targets.__getitem__):
                raise ValueError("%s: %s" % (entry.path, entry.rule.sentence(targets.__getitem__)))

    cdef bint allow(self, const LiveParameter *parameters, const Letter *letter) noexcept nogil:
        """Return whether the targets obey the rules after the changes of a letter, all together."""
        cdef int index
        if self.count == 0:
            return True
        for index in range(self.parameter_count):
            self.values[index] = parameters[index].target
        for index in range(letter.count):
            self.values[letter.parameters[index]] = letter.values[index]
        for index in range(self.count):
            if self.touches(&self.rules[index], letter) and not self.holds(&self.rules[index]):
                return False
        return True

    cdef bint touches(self, const LiveRule *rule, const Letter *letter) noexcept nogil:
        cdef int term, index
        for term in range(rule.first, rule.last):
            for index in range(letter.count):
                if self.terms[term].parameter == letter.parameters[index]:
                    return True
        return False

    cdef void keep(self, LiveParameter *parameters, double dt) noexcept nogil:
        """Change the values of the next tick where they would break a rule. They obey it in this tick (`before`)."""
        cdef int index
        for index in range(self.parameter_count):
            self.values[index] = parameters[index].value
        for index in range(self.count):
            if not self.holds(&self.rules[index]):
                self.straighten(parameters, self.rules[index].group, dt)

    cdef void straighten(self, LiveParameter *parameters, int group, double dt) noexcept nogil:
        """Move a group along the straight line to its targets, as far as every slew allows."""
        cdef int index
        cdef double share = 1.0
        cdef double rest
        for index in range(self.parameter_count):
            if parameters[index].group == group:
                rest = fabs(parameters[index].target - parameters[index].before)
                if rest > parameters[index].slew * dt:
                    share = fmin(share, parameters[index].slew * dt / rest)
        self.follow_line(parameters, group, share)
        self.hold_back(parameters, group)
        if not self.move(parameters, group):
            self.follow_line(parameters, group, share)
            if not self.nearly_hold(group):     # the targets break a rule: half of a request has been replayed
                self.follow_line(parameters, group, 0.0)
        for index in range(self.parameter_count):
            if parameters[index].group == group:
                parameters[index].value = self.values[index]

    cdef void follow_line(self, const LiveParameter *parameters, int group, double share) noexcept nogil:
        cdef int index
        cdef const LiveParameter *parameter
        for index in range(self.parameter_count):
            parameter = &parameters[index]
            if parameter.group == group:
                self.values[index] = parameter.target if share >= 1.0 else approach(
                    parameter.before, parameter.target, share * fabs(parameter.target - parameter.before))

    cdef void hold_back(self, const LiveParameter *parameters, int group) noexcept nogil:
        """Hold the parameters whose motion breaks a rule. Without it the rule is obeyed as in the previous tick."""
        cdef int index
        cdef const LiveRule *rule
        cdef bint held = True
        while held:
            held = False
            for index in range(self.count):
                rule = &self.rules[index]
                if rule.group == group and not self.holds(rule):
                    held |= self.hold_terms(parameters, rule.first, rule.middle, 1.0)
                    held |= self.hold_terms(parameters, rule.middle, rule.last, -1.0)

    cdef bint hold_terms(self, const LiveParameter *parameters, int first, int last, double sign) noexcept nogil:
        """Hold the parameters of a side that move towards the other. Returns whether there are any."""
        cdef int term, which
        cdef bint held = False
        for term in range(first, last):
            which = self.terms[term].parameter
            if sign * self.terms[term].factor * (self.values[which] - parameters[which].before) > 0.0:
                self.values[which] = parameters[which].before
                held = True
        return held

    cdef bint move(self, const LiveParameter *parameters, int group) noexcept nogil:
        """Return whether any parameter of a group moves."""
        cdef int index
        for index in range(self.parameter_count):
            if parameters[index].group == group and self.values[index] != parameters[index].before:
                return True
        return False

    cdef bint nearly_hold(self, int group) noexcept nogil:
        """Return whether the rules of a group hold to rounding."""
        cdef int index, term
        cdef double size
        cdef const LiveRule *rule
        for index in range(self.count):
            rule = &self.rules[index]
            if rule.group != group:
                continue
            size = fabs(rule.small) + fabs(rule.large)
            for term in range(rule.first, rule.last):
                size += fabs(self.terms[term].factor * self.values[self.terms[term].parameter])
            if not (self.sum(rule.first, rule.middle, rule.small) <= self.sum(rule.middle, rule.last, rule.large)
                    + ROUNDING * size):
                return False
        return True

    cdef bint holds(self, const LiveRule *rule) noexcept nogil:
        """Return whether `values` obey a rule. As cext.rules.Rule.holds, to the last bit."""
        cdef double small = self.sum(rule.first, rule.middle, rule.small)
        cdef double large = self.sum(rule.middle, rule.last, rule.large)
        return small < large if rule.strict else small <= large

    cdef double sum(self, int first, int last, double constant) noexcept nogil:
        cdef int term
        for term in range(first, last):
            constant += self.terms[term].factor * self.values[self.terms[term].parameter]
        return constant
