/* Binary data of a playground, which are in base64 of gzip. */

export async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export async function unpackedNumbers(text) {
  const bytes = await unpacked(text);
  return new Float64Array(bytes.buffer, 0, bytes.byteLength / 8);
}

export async function unpackedJson(text) {
  return JSON.parse(new TextDecoder().decode(await unpacked(text)));
}
