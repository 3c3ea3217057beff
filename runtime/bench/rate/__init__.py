"""`python -m runtime rate`: the highest rate at which one to eight actuators are commanded and none of them misses an
answer.

That is the maximum operating frequency of Leestma et al. 2025, with every missing answer counted.

robot       the diagram: so many actuators that are commanded nothing
search      bisection
steps       one step of it: simulated in virtual time, or on a rig
picture     what was found beside what the bus can do
command     the command line, and what it prints
"""
