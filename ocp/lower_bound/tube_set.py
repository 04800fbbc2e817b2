"""stub"""
import numpy as np
from swarmstart.ocp.lower_bound.evidence import Tube
def _levels(tube,t):
    i=np.clip(np.searchsorted(tube.times,t,side="right")-1,0,len(tube.times)-2)
    f=(t-tube.times[i])/(tube.times[i+1]-tube.times[i])
    return (tube.levels[i]*(1-f)[:,None]+tube.levels[i+1]*f[:,None]).T
def inside(tube,points): return (tube.directions@points[1:]<=_levels(tube,points[0])).all(0)
def outside(tube,lower,upper):
    s=np.maximum(_levels(tube,lower[0]),_levels(tube,upper[0]))
    D=tube.directions[:,:,None]
    least=np.minimum(D*lower[1:],D*upper[1:]).sum(1)
    return (least>s+1e-9).any(0)
def starting_boxes(tube):
    n=tube.directions.shape[1]
    s=np.maximum(tube.levels[:-1],tube.levels[1:])
    up=np.vstack([tube.times[1:],s[:,0:2*n:2].T]); lo=np.vstack([tube.times[:-1],-s[:,1:2*n:2].T])
    return lo,up
