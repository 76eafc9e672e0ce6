"""A mesh drawn by WebGL alone, turning: what a browser reaches without anybody's viewer.

    window.drawn       pictures so far
    window.renderer    who computes them, in the driver's own words

One program, one buffer of points and one of colours, as few calls as there can be.
"""

from __future__ import annotations

import base64
import json

import numpy as np

from maxjax.core.grid import Point3
from maxjax.ui.page.nodes import Surface

_PAGE = """<body style="margin:0"><canvas id="c" width="%(width)d" height="%(height)d"></canvas><script>
const gl = c.getContext('webgl2', {antialias: true});
const told = gl.getExtension('WEBGL_debug_renderer_info');
window.renderer = gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
window.drawn = 0;
const bytes = text => Uint8Array.from(atob(text), x => x.charCodeAt(0));
const compiled = (kind, text) => {
    const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s); return s;
};
const program = gl.createProgram();
gl.attachShader(program, compiled(gl.VERTEX_SHADER, `#version 300 es
    uniform mat4 m; in vec3 p; in vec3 color; out vec3 seen;
    void main() { gl_Position = m * vec4(p, 1.0); seen = color; }`));
gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, `#version 300 es
    precision mediump float; in vec3 seen; out vec4 shown;
    void main() { shown = vec4(seen, 1.0); }`));
gl.bindAttribLocation(program, 0, 'p'); gl.bindAttribLocation(program, 1, 'color');
gl.linkProgram(program); gl.useProgram(program);
const filled = (kind, data) => { gl.bindBuffer(kind, gl.createBuffer()); gl.bufferData(kind, data, gl.STATIC_DRAW); };
filled(gl.ARRAY_BUFFER, bytes(%(points)s));
gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0); gl.enableVertexAttribArray(0);
filled(gl.ARRAY_BUFFER, bytes(%(colors)s));
gl.vertexAttribPointer(1, 3, gl.UNSIGNED_BYTE, true, 0, 0); gl.enableVertexAttribArray(1);
filled(gl.ELEMENT_ARRAY_BUFFER, bytes(%(faces)s));
gl.enable(gl.DEPTH_TEST); gl.enable(gl.CULL_FACE); gl.clearColor(1, 1, 1, 1);
const eye = %(eye)s, target = %(target)s;
const minus = (a, b) => a.map((x, k) => x - b[k]), dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const cross = (a, b) => [a[1]*b[2] - a[2]*b[1], a[2]*b[0] - a[0]*b[2], a[0]*b[1] - a[1]*b[0]];
const unit = a => a.map(x => x / Math.hypot(...a));
const seenFrom = place => {
    const back = unit(minus(place, target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    const near = 0.1, far = 5000, high = 1 / Math.tan(%(fov)r / 2), wide = high * c.height / c.width;
    const depth = [...back.map(x => x * (far + near) / (near - far)), 2 * far * near / (near - far)];
    depth[3] -= dot(back, place) * (far + near) / (near - far);
    const row = (axis, scale) => [...axis.map(x => x * scale), -dot(axis, place) * scale];
    const rows = [row(right, wide), row(up, high), depth, row(back, -1)];
    return new Float32Array(16).map((_, k) => rows[k %% 4][k >> 2]);
};
const where = gl.getUniformLocation(program, 'm');
const draw = () => {
    const turn = 0.01 * window.drawn++, away = minus(eye, target), s = Math.sin(turn), o = Math.cos(turn);
    const place = [target[0] + o*away[0] - s*away[1], target[1] + s*away[0] + o*away[1], eye[2]];
    gl.uniformMatrix4fv(where, false, seenFrom(place));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawElements(gl.TRIANGLES, %(count)d, gl.UNSIGNED_INT, 0);
    requestAnimationFrame(draw);
};
draw();
</script></body>"""


def turning(mesh: Surface, eye: Point3, target: Point3, size: tuple[int, int], fov: float) -> str:
    """HTML that draws a mesh from a place that turns about a point.

    Args:
        mesh: its triangles and colours.
        eye: first place of the camera [m].
        target: what it looks at, and turns about [m].
        size: width and height of the canvas [px].
        fov: angle from top to bottom [rad].
    """

    def kept(array: np.ndarray) -> str:
        return json.dumps(base64.b64encode(np.ascontiguousarray(array).tobytes()).decode())

    return _PAGE % {
        "width": size[0],
        "height": size[1],
        "points": kept(mesh.points.astype("<f4")),
        "colors": kept(mesh.colors.astype("u1")),
        "faces": kept(mesh.faces.astype("<u4")),
        "count": mesh.faces.size,
        "eye": json.dumps(list(eye)),
        "target": json.dumps(list(target)),
        "fov": fov,
    }
