/* Texts as a zip file without compression. */

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, k) => {
  let value = k;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

export function checksum(bytes) {
  let value = 0xffffffff;
  for (const byte of bytes) value = CRC_TABLE[(value ^ byte) & 255] ^ (value >>> 8);
  return (value ^ 0xffffffff) >>> 0;
}

/* Returns the zip file. Equal texts give equal bytes, since all files have the same date.
   - `files`: texts by file name. */
export function zipped(files) {
  const encoder = new TextEncoder();
  const parts = [];
  const listed = [];
  let offset = 0;
  for (const [name, text] of Object.entries(files)) {
    const [title, body] = [encoder.encode(name), encoder.encode(text)];
    const common = fields([[20, 2], [0x0800, 2], [0, 2], [0, 2], [0x5821, 2], [checksum(body), 4], [body.length, 4],
      [body.length, 4], [title.length, 2], [0, 2]]);
    parts.push(fields([[0x04034b50, 4]]), common, title, body);
    listed.push(fields([[0x02014b50, 4], [20, 2]]), common, fields([[0, 2], [0, 2], [0, 2], [0, 4], [offset, 4]]), title);
    offset += 30 + title.length + body.length;
  }
  const count = Object.keys(files).length;
  const size = listed.reduce((sum, part) => sum + part.length, 0);
  const end = fields([[0x06054b50, 4], [0, 2], [0, 2], [count, 2], [count, 2], [size, 4], [offset, 4], [0, 2]]);
  return new Blob([...parts, ...listed, end], { type: "application/zip" });
}

function fields(values) {
  const bytes = [];
  for (const [value, size] of values) for (let k = 0; k < size; k++) bytes.push((value >>> (8 * k)) & 255);
  return Uint8Array.from(bytes);
}
