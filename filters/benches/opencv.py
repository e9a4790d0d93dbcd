"""The other side of benches/gaussian.rs: answers each line `REPEATS` with the seconds of so many calls of
cv2.GaussianBlur, in one thread, on the picture in the file named on the command line."""
import sys
import time

import cv2
import numpy

path, width, height, channels, size, sigma = sys.argv[1:]
cv2.setNumThreads(1)
image = numpy.fromfile(path, numpy.float32).reshape(int(height), int(width), int(channels))
size = (int(size), int(size))
output = numpy.zeros_like(image)


def blur():
    cv2.GaussianBlur(image, size, float(sigma), output, float(sigma), cv2.BORDER_REPLICATE)


blur()
output.tofile(path + ".blurred")
print(cv2.__version__, flush=True)
for line in sys.stdin:
    seconds = []
    for _ in range(int(line)):
        start = time.perf_counter()
        blur()
        seconds.append(time.perf_counter() - start)
    print(*seconds, flush=True)
