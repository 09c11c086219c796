"""The console in the browser: what the stack tells, and buttons for what an operator may ask of it.

`ros_side` listens and calls; `facts` is what is known, as plain data; `scene` draws it in 3D (viser); `server` is the page, its
socket and who may use them (tornado); `page/` is what the browser loads; `running` puts them together.
"""
