"""Plans and flights as files of others: text and bytes, from arrays alone.

    paths          positions of a vehicle over time, and an origin on the earth
    pieces         polynomials over windows of time, with their largest error
    crazyswarm     CSV of polynomials of degree 7
    skybrush       .skyc, a show of Bezier curves
    ros            a bag of ROS 2 in MCAP
    missions       .plan of QGroundControl, and waypoints as text: no times
    tables         CSV with units

Nothing is read or written here.
"""
