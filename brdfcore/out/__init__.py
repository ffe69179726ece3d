"""Tables taken elsewhere: functions of arrays of any library, shaders."""
