"""A link to a vehicle over MAVLink: plans become missions or set-points in flight (extra `mavlink`).

    connect → ready? → home of the plan? → arm, where asked → follow → a log of what was flown

Whatever goes wrong ends in a sentence (`LinkError`), with the vehicle left in a safe mode of its own.
"""
