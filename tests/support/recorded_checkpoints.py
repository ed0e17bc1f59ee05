# SPDX-License-Identifier: GPL-3.0-or-later
"""Checkpoints as torch 2.9.0 saved them, in what NICE-SLAM's Logger and Co-SLAM's save_ckpt give to torch.save.

Frame k is turned by 0.3 k rad about z and stands at (k / 4, -k / 2, k^2 / 8); the camera's axes are OpenGL's.
NICE-SLAM's file has 6 frames, of which 0 to 4 are estimated, in torch's old format. Co-SLAM's has 6 frames in the new
one, on "cuda:0", of which 0 and 5 are keyframes; the tensor of frame 0 is the second half of its storage.
"""

import base64
import zlib

import numpy as np


def pose_of(k):
    """The camera-to-world pose of frame k, OpenCV's axes."""
    cos, sin = np.cos(0.3 * k), np.sin(0.3 * k)
    return np.array([[cos, -sin, 0, 0.25 * k], [sin, cos, 0, -0.5 * k], [0, 0, 1, 0.125 * k * k], [0, 0, 0, 1.0]])


def _bytes(text):
    return zlib.decompress(base64.b64decode(text))


NICE_SLAM = _bytes("""
eNrlVEtv3FQUtj0zSePSMi3lUSD0DQ6PMPFMJg6PmVDStKnbtHV4GKTIcexLbPCMc3zvtARppGyYtohFd0ioP4BNFywREqn6H/ojuuqKBVIXPdeP
tHFcIURZ4dHY5557zne++91z74b0gxw8uDn31+Gvf7l4cHxDOn+vhO8+CIpZFQRhLQpZ6ISBdZlE1A+7IGKAuQdnAp+xgFik6/p2F6RrpoxOtr5G
LOp/RyiU+lBWzAo6qRdGDCq6ZJZw5HcZDOlls8wxwu4qDOvlXi+rKaLXAbEPkrkbzdXId62O77oBgZLDwsjxxq0e8wMqWxFZ6fmBazHSpWFkXVZl
LKiYw7wiRtqrBCpJijwXhDZbTJwyDJl7MWa6rjUmtYmpuqrWtBoMx+SctR7s0qUFBiOXdEHRRV3CP/4YyEpm89Hu6w6qEhCHoShUvhC5JCLurO8w
GZ4ZM2APg70GPEvN/YjqEifEeYsymxHLxSCoejxqn2IO4fwV4q96DPZ7yN+reDl+Ew11sgnPeQmvA8iL0xrA85zPAF64HkO9yOAlAw7Gsq74NoWX
n4TWqNXgFUQTEe3VGO17GOWv1xKkQwwOG3Ck14ej5gimWh3CbNdmNhyL54+b6BTgRB9ej8XOOuMNXaSUriT7xixHvWIFPmWg7CQypdaa9drEtApj
SGQZibzJiWBb6OWr8JZeRUO8Cm8nhN5hMG7Au+Y+TCeU+R2u4hZ8rWidzUmtgT+YSOHVx+DrGXwjgZ9k0DRgKm7qb8j6V5HdIQm0tgTTii4kBdJW
Ooctu9VJ7+W0rWtTKryfavsB1hwbS2p8yKBlQJvE7UAJ7xviWlk1CjN9+EgvL8HJPnysJMfE/RZmdSHuj0RNOFUopFav1etNmMOqVax6mq8U1zmA
M3yVA5hPGJxloBtwLt4xFDEGPP8kQHzDQgp4YQvwYgJ4KQE0GCwa8EnPpt7sNoXmu4+O2qfbkVWtqWnwWSrQ548JZDL4woAv+T2wxO+BglYRi7Ck
Ii1KRespF/VHpWgDC8/fcNEx2lV0k4yQ8WUhezbawo7nn/j+7/n/7hHTL78Uq09pT/4GZzMzCnzbcJafEs79G6zdWfiplY5b3EZfFruZy2/l89X5
xbb/YzXjENvo29xZM7bb+fy7Rw61R6+dSf0zsY2+NO92Lv/Gjvw/B7+1Rn/utrMxt9H3RxpwO1d/5r/qESn3Pbp+6/ebzTutbP7XBwc2pVzuQ9gB
rl8=
""")

CO_SLAM = _bytes("""
eNqtmFlsG0UYx9eO46ROj5Q29EjTpE1oTdI6PtZHCskGU9y0S1t304JJD9ext7GJE+ezxz1AFRHQiAIS4QlUIcQrlUBCQhxCrSuEhMoDooi2CHFU
QkLiqQ+IJ5BgxrNZdsfrTWOzku3xev6/77/fzn4z46jYYOO45mau4tjE2blkLl7IJqbiybScnJzJZaaRvz+VQAnXzGQ2ErZyY2Oz1vPAOWOYwc3k
CjJYzoPVKXJJlMsn0654EWWyBUc8L48XM9lUHMnThVw+ftrrgAanM9aEVQXcMzEhg41KHJFsLoFG6UkHNMYsuI8b7DE7/kwWU4ldbmgSuxA0HxJb
RZtom4Nl+MMyB46LyWQum5WTKJObLjgO5lNyXk7tziSRA1oelGA5ghUSrBQtaRw6bUtTtAdWpZvEVgSth0SO8lZT3n0X00S2BsFaCdpEq07mhfup
bJ0qW09lG6hsI4J2CTaJDTqZDzqobLMq66SyLirbgmCrBN2iTSfjoYfKHlBl26hsO5U5EeD3XrFRJ/NDH5XtUGU7qcxFZf0I3BJ4irFm5fbhG5UF
73nw4VuoQwWApyi/igpQVJCiQggGJNjFZDcID1HZw6pskMqGqExAMCzBI0x2QxCmskdV2W4qe4zKIgj2SDDCZHcA9lLZPlUmUtnjVLYfwQEJDmqy
ayVDwA1Rqjuk6iSqG6W6wwiOSPBEMdaIu0/lUjhJT5Z/iDnL4/KMnJlII3hKj/XAGMZaERwlWItonYNjopVgj1PsCQRxCU6WH57xTKIACT3AC+MY
YEGQLAMuQIq8yVR8CsGEBOlYC+6ZTmRPuRQTGcpQnqYR/Iv6MD1NsT6YpL6yqq8p6muaonMIZiSA2LIFdNlcXjGnUHgoUHNIMVckb6cp4QyCsxKc
KxZdUbGpuef1y1u68EWSV7RqvenmVhnWG9epXH4qgeKn5XwBP9mRcAsuO+rhIQE+vvvjC2QAkFf1ANu4PuMASgmKJ7KZiekpeRpFwtu1McyOAE8M
CGfgd5IVq6mBDs5naGD8HJJzpFxFwv33GnfhyGYQysrEw4XBXzeQwWg39bCR81at6v3uSNi1RANvDlpK+/46JlD6HYG08Tnl+8lr/0WeLXHcF8N6
N7MCfbEH6UsbBud0enLle75yvTurdDa78lD1K/dEwvxSU18+7s4jYerAG0OKnyHSxucWvJYY/0NG/v3vR3tIYoZr9++t1b9376iQebV14R6U2/hc
qTLn5bZg5H/Npd9Cdfr31er/5pZOoeOlEcXXcLmNzym+rzH+5w39Z3453lenf75W/3/OfTrUcWlaWPBD2vjcVSUo8/xww0b+f7rT1l+nf3+t/i//
PD948+hziv93BNLG567Q712M/xFD/7ePX2+v03+gVv//R/1Bd6LROv0H66w/V5n6IxjUH6Fa/TnxxysH6/QfqrP+lJj6IxjUH6Fa/Tn75eBonf4H
6qw/Jab+CAb1R6hWf6zPzw0v7r+dC5rMX3jq9nG1158SU3+GDOqPUK3+fHTl6931+vfU6H/rufc+eyvw+RDxcevZ6y+TwM2L+Og38YEn0r6l+Pjg
77UlEruzsWc/WcfbFontM4ntq2H91/vJsQ9J/O6xF/+pNz5fQ/zVXhI9d/L2D4uvf9s5v2F0dWXvWfoI8DlI/BtvTxxZPH4v3gIYbgDKl1+Q8xm8
A3gmQf4/iGdSkfDWe7Dj4d3eYJD3+wMB3uf3egMDA353gHfzIT4QCgaCngG/J8h7ytuUydfEtBP7cJZdWohZ1ad2j7SpwrnZ/zAsSbsZ6tZRZmzc
veywWKB2c7NNB7xRDVixo2KZ2s1Kh44pNXLmmyQWpV39b9ShbjVyJnsdlqNdhes539hNOB6Wo10N6znzTSYcL8vRrkr1nGizCcfHcrSrQz2ndZkJ
h2c52lUakx8zjp/laFdLTH4cJpwAy9GuWpj8tJhwgixHu3pg8rPchBNiOdpZnMmPGWeA5Whn03Z9flaYjcOKAa2dDvWg6EozUMWI1s5tetD3pqCK
Ia2dpPSgw6vMQBVjWjvf6EHfmYIqBrV24tCDpFbObLJiQdra3qsDfVsFZDzrREW7fYei3NywU6W0MZ/r7croXa3cUtHeVB4j6+h3+ldYo51q2sr9
ad9/ARGCYBE=
""")
