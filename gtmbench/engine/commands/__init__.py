"""How an aircraft answers its commands, over a whole log: whether a surface failed, or a sensor that looks like one."""
