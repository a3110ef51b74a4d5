"""A campaign: scenarios times axes, flown task by task, on as many processes and machines as there are."""
